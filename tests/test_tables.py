"""Tables of README and documentation are what their records give, and say how old they are."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks import records
from benchmarks.__main__ import main
from benchmarks.records import ROOT, Record, commit_of, load_records, source_digest
from benchmarks.run_log import NAME
from benchmarks.studies import STUDIES
from benchmarks.tables import filled, named, pages, unmarked, write_tables
from twosra_mpc import InputError

PAGES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in pages()}
RECORDS = load_records()
MEASURED = re.compile(r"\|[^|\n]* of \d+ (?=\|)|\|[^|\n]*\d+(?:\.\d+)? / \d[^|\n]*(?=\|)")


def invoke(*arguments: str | Path) -> tuple[int, str]:
    done = CliRunner().invoke(main, list(map(str, arguments)))
    return done.exit_code, done.output


@pytest.mark.parametrize("page", PAGES)
def test_tables_are_those_of_their_records(page: str) -> None:
    text = unmarked(PAGES[page])
    again = unmarked(filled(text, RECORDS))
    assert again == text, "python -m benchmarks tables"
    assert text.count("<!-- table: ") == text.count("<!-- end of table: ") == again.count("<!-- t")


def test_every_record_stands_in_one_place() -> None:
    shown = [name for text in PAGES.values() for name in named(text)]
    assert sorted(shown) == sorted(RECORDS)


@pytest.mark.parametrize("page", PAGES)
def test_no_measurement_is_typed_into_a_table(page: str) -> None:
    typed = re.sub(r"<!-- table: .*?<!-- end of table: ", "", PAGES[page], flags=re.DOTALL)
    assert not MEASURED.findall(typed)


@pytest.mark.parametrize("name", RECORDS)
def test_every_record_is_what_a_study_makes_of_its_standing_set(name: str) -> None:
    """Its command, its settings and the names of its columns are the study's: none is typed in."""
    record = RECORDS[name]
    assert set(record.command.split()[:-1]) == {"python", "-m", "benchmarks"}
    study = STUDIES[record.command.split()[-1]]
    assert record.settings == study.model_dump(mode="json")
    assert record.cases == len(list(study.cases()))
    assert record.measures.keys() == set(study.measures)
    assert {"highspy", "casadi", "mujoco", "source"} <= record.versions.keys()
    assert record.machine


def test_every_study_has_a_record_and_all_of_them_take_half_an_hour_of_cpu() -> None:
    spent_s = {record.command: record.cpu_s for record in RECORDS.values()}
    assert {command.split()[-1] for command in spent_s} == set(STUDIES)
    assert sum(spent_s.values()) < 1800


def test_every_study_is_told_of() -> None:
    told = re.findall(r"^\| (`.*`) \|", PAGES["docs/guide/benchmarks.md"], re.MULTILINE)
    assert {name for cell in told for name in re.findall("`(.*?)`", cell)} == set(STUDIES)


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tree without history: two folders that are measured, a record of each, and a page."""
    for folder in ("planning", "execution"):
        (tmp_path / "twosra_mpc" / folder).mkdir(parents=True)
        (tmp_path / "twosra_mpc" / folder / "code.py").write_text(folder)
    (tmp_path / "docs").mkdir()
    (tmp_path / "benchmarks" / "records").mkdir(parents=True)
    for number, folder in enumerate(("planning", "execution")):
        path = f"twosra_mpc/{folder}"
        Record(
            **{"command": "count", "date": "2026-11-23", "commit": "abc1234"},
            **{"cases": 2, "cpu_s": 3.0, "settings": {}, "machine": {}, "versions": {}},
            measures={path: source_digest(tmp_path / path)},
            columns=("reached",),
            rows=((f"{number} of 2",),),
        ).save(tmp_path / "benchmarks" / "records" / f"{folder}.json")
    both = "<!-- table: planning execution -->\n<!-- end of table: planning execution -->\n"
    (tmp_path / "README.md").write_text(f"Before.\n\n{both}\nAfter.\n")
    monkeypatch.setattr(records, "ROOT", tmp_path)
    return tmp_path


def test_a_table_says_what_has_changed_since_it_was_measured(clone: Path) -> None:
    page, code = clone / "README.md", clone / "twosra_mpc" / "execution" / "code.py"
    assert invoke("tables", "--check-release") == (0, "")
    fresh = page.read_text()
    assert (
        "| reached |\n|---|\n| 0 of 2 |\n| 1 of 2 |\n\n*`count`: 2 cases, 3 s of CPU, measured"
        in fresh
    )
    assert fresh.startswith("Before.\n\n<!-- table")
    assert fresh.endswith("execution -->\n\nAfter.\n")

    code.write_text("changed")
    exit_code, said = invoke("tables", "--check-release")
    assert (exit_code, said) == (1, "execution: what it measures has changed since\n")
    assert "*Changed since then in twosra_mpc: execution.*" in page.read_text()
    assert unmarked(page.read_text()) == fresh  # nothing else needs to be written again

    code.write_text("execution")
    assert write_tables(clone) == []
    assert page.read_text() == fresh


def test_what_does_not_fit_together_is_refused_by_name(clone: Path) -> None:
    page, folder = clone / "README.md", clone / "benchmarks" / "records"
    text = page.read_text()
    page.write_text(text.replace("planning execution", "planning"))
    with pytest.raises(InputError, match="record = 'execution'"):
        write_tables(clone)
    page.write_text(text.replace("planning execution", "planning elsewhere"))
    with pytest.raises(InputError, match="table = 'elsewhere'"):
        write_tables(clone)
    page.write_text(text)
    record = load_records(folder)["planning"]
    record.with_values(columns=("touched",)).save(folder / "planning.json")
    with pytest.raises(InputError, match="the same columns"):
        write_tables(clone)


@pytest.mark.skipif(not shutil.which("git"), reason="there is no git")
def test_a_record_names_the_last_commit_that_changed_what_it_measures(clone: Path) -> None:
    def git(*arguments: str) -> str:
        who = ("-c", "user.name=me", "-c", "user.email=me@example.com")
        command = ("git", "-C", str(clone), *who, *arguments)
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    def commit(path: Path, text: str) -> str:
        path.write_text(text)
        git("add", "-A")
        git("commit", "-q", "-m", text)
        return git("rev-parse", "HEAD")

    measured = clone / "twosra_mpc" / "planning"
    with pytest.raises(InputError, match="a clone with its history"):
        commit_of(["twosra_mpc/planning"], clone)
    git("init", "-q")
    first = commit(measured / "code.py", "one")
    commit(clone / "README.md", "another")
    assert first.startswith(commit_of(["twosra_mpc/planning"], clone))
    (measured / "code.py").write_text("two")
    (clone / "README.md").write_text("three")
    with pytest.raises(InputError, match=r"planning/code\.py.*a tree without changes"):
        commit_of(["twosra_mpc/planning"], clone)
    assert commit_of(["twosra_mpc/execution"], clone)


def test_a_finished_study_becomes_a_record(
    clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = clone / "benchmarks" / "records"
    monkeypatch.setattr(records, "FOLDER", folder)
    monkeypatch.setattr("benchmarks.__main__.commit_of", lambda *_: "abc1234")
    run = tmp_path / "run"
    settings = ("--set", "count=2", "--set", "robots=2", "--set", "time_limit_s=0.1")
    assert invoke("soak", "--out", run, *settings)[0] == 0
    exit_code, said = invoke("record", run)
    assert exit_code == 2
    assert "record = 'soak'" in said  # which stands in no page yet
    with (clone / "README.md").open("a") as page:
        page.write("<!-- table: soak -->\n<!-- end of table: soak -->\n")
    assert invoke("record", run)[0] == 0
    made = load_records(folder)["soak"]
    assert made.command == (
        "python -m benchmarks soak --set count=2 --set robots=2 --set time_limit_s=0.1"
    )
    assert (made.cases, made.commit) == (2, "abc1234")
    assert made.cpu_s > 0
    assert [row[:2] for row in made.rows] == [("1", "1"), ("2", "2")]
    assert (
        f"| {' | '.join(made.rows[1])} |\n\n*`{made.command}`" in (clone / "README.md").read_text()
    )

    log = run / NAME
    log.write_text(log.read_text().replace('"source": "', '"source": "0'))
    exit_code, said = invoke("record", run)
    assert exit_code == 2
    assert "versions.source" in said
    log.write_text("{}\n")
    assert invoke("record", run)[0] == 2


def test_one_command_runs_what_is_not_finished_and_makes_every_record_anew(
    clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted in its second study, it begins there again, and both have records in the end."""
    folder, begun = clone / "benchmarks" / "records", list[str]()
    small = {name: STUDIES[name] for name in ("goals", "passages")}
    given = {"goals": "count=2", "passages": "widths_m=[0.05]"}
    stops = iter([0, 130, 0, 0])

    def in_this_process(name: str, out: Path) -> int:
        begun.append(name)
        return next(stops) or invoke(name, "--out", out, "--set", given[name])[0]

    monkeypatch.setattr(records, "FOLDER", folder)
    monkeypatch.setattr("benchmarks.__main__.commit_of", lambda *_: "abc1234")
    monkeypatch.setattr("benchmarks.__main__.STUDIES", small)
    monkeypatch.setattr("benchmarks.__main__._in_a_process", in_this_process)
    with (clone / "README.md").open("a") as page:
        page.writelines(f"<!-- table: {x} -->\n<!-- end of table: {x} -->\n" for x in small)
    out = tmp_path / "out"
    assert invoke("all", "--out", out)[0] == 130
    assert "goals" in load_records(folder)
    assert "passages" not in load_records(folder)
    before = (out / "goals" / NAME).read_bytes()
    exit_code, said = invoke("all", "--out", out)
    assert exit_code == 0
    assert "s of CPU in all" in said
    assert (out / "goals" / NAME).read_bytes() == before
    assert begun == ["goals", "passages"] * 2
    made = load_records(folder)
    assert {made[name].cases for name in small} == {1, 2}
    assert made["goals"].command == "python -m benchmarks goals --set count=2"
    assert "| 50.0 | blocked |" in (clone / "README.md").read_text()
