"""The seams of the architecture, read off the source: imports, CasADi's values, type tests."""

from __future__ import annotations

import ast
import functools
import graphlib
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

from twosra_mpc import load_problem, plan

PACKAGE = Path(__file__).parent.parent / "twosra_mpc"
MODULES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))

# What proves lower bounds anew shares nothing with the planner but the values that say what the
# problem is, and may ask which kinds they are: it has a second account of each.
CERTIFICATES = (
    *("checking/certificate.py", "checking/events.py"),
    *("checking/body.py", "checking/fibre.py", "checking/legs.py", "checking/melts.py"),
)
OF_CERTIFICATES = (
    *("twosra_mpc.errors", "twosra_mpc.problem.problem", "twosra_mpc.problem.tolerances"),
    *("twosra_mpc.problem.goals", "twosra_mpc.problem.tasks", "twosra_mpc.problem.world"),
    "twosra_mpc.robot.",
    *("twosra_mpc.thermal.lumped", "twosra_mpc.thermal.two_node", "twosra_mpc.thermal.uncertainty"),
    *(f"twosra_mpc.{module[:-3].replace('/', '.')}" for module in CERTIFICATES),
)

# Library -> where in the package it may be imported.
ALLOWED = {
    "casadi": (
        "model/",
        "problem/limits.py",
        "problem/speeds.py",
        "problem/goals.py",
        "checking/reintegration.py",
        "planning/solver/",
        "execution/tracking/",
        "lab/serial/markers.py",
    ),
    "matplotlib": ("plotting/", "lab/figures/"),
    "tomlkit": ("robot/description.py", "lab/commands/", "lab/identification/", "lab/report/"),
    "jinja2": ("files.py",),
    "highspy": ("planning/bounds/linear_program.py",),
    "osqp": ("execution/tracking/",),
    "shapely": (
        *("space/", "problem/world.py", "problem/geojson.py", "checking/clearance.py"),
        "lab/worlds/",
    ),
    "serial": ("lab/serial/port.py",),
    "mujoco": ("physics/",),
    "glfw": ("physics/",),
    "flint": CERTIFICATES,
    "skimage": ("lab/photographs/published_steps.py",),
    "similaritymeasures": ("lab/reproduction/hardware.py",),
    "mcap_ros2": ("lab/export/",),
    "dask": ("lab/batch/",),
    "distributed": ("lab/batch/",),
    "pyarrow": ("lab/batch/",),
    "pandas": ("lab/batch/", "lab/figures/atlas"),
    "click": ("cli/", "lab/commands/"),
    "starlette": ("lab/studio/server.py",),
    "uvicorn": ("lab/studio/server.py",),
    "IPython": ("lab/studio/server.py",),
    "rich": ("cli/", "lab/commands/"),
    "pydantic": (
        *("validation.py", "robot/", "problem/", "plans/result.py"),
        *("lab/batch/", "lab/schema.py"),
        "execution/tracking/setup.py",
    ),
    "pydantic_core": ("validation.py",),
    # No decision of a planner looks at a clock: it counts its work. Two say how long they took.
    "time": (
        *("effort.py", "planning/planner.py", "planning/greedy.py"),
        *("execution/", "physics/", "lab/"),
    ),
    "yaml": ("lab/worlds/occupancy_map.py",),
}
# What only extras bring, and the modules that import it at once: those that nobody else imports.
EXTRAS = {"dask", "distributed", "flint", "gymnasium", "IPython", "mcap_ros2", "mujoco", "pandas"}
EXTRAS |= {"pyarrow", "serial", "similaritymeasures", "skimage", "starlette", "uvicorn"}
WITH_EXTRAS = {*CERTIFICATES, "planning/proof.py", "lab/batch/workers.py"}
# Against the flow, inside a function: module and what it imports -> why.
AGAINST_THE_FLOW = {
    ("plans/plan.py", "twosra_mpc.plotting.plan_figures"): "a notebook shows a plan as its figure",
}
# Stages in the direction of flow; a module may import from its own stage and from those before it.
STAGES = [
    (
        "installation.py",
        "errors.py",
        "effort.py",
        "interrupts.py",
        "native_output.py",
        "files.py",
        "native_output.py",
        "keys.py",
        "arguments.py",
        "validation.py",
    ),
    ("thermal/",),
    ("robot/",),
    ("model/",),
    ("control/",),
    ("problem/",),
    ("space/",),
    ("contact/",),
    ("timing/",),
    ("plans/trajectory.py", "plans/speed_profile.py"),
    ("planning/bounds/",),
    ("planning/search/",),
    ("plans/",),
    ("checking/",),
    ("planning/stages/",),
    ("planning/solver/",),
    ("planning/",),
    ("execution/tracking/",),
    ("physics/",),
    ("execution/",),
    ("plotting/",),
    ("__init__.py",),
    ("cli/",),
    ("lab/",),
    ("__main__.py",),
]


# What a robot or a scenario chooses among -> where code may ask which one it is. Anywhere else it
# asks the record's model, so that another one can be added without a change there.
OPEN_RECORDS = {
    "robot/paths.py": ("robot/", "model/", "lab/identification/", *CERTIFICATES),
    "robot/segment.py": ("robot/", "lab/identification/", *CERTIFICATES),
    "robot/timing.py": ("robot/", "timing/", *CERTIFICATES),
    "problem/goals.py": ("problem/",),
    "problem/tasks.py": ("problem/",),
}
TOP_LEVEL_MODULES = 12  # at most

# Modules that still take values from CasADi. The list may only become shorter, with the code.
CASADI_VALUES_OUTSIDE = frozenset(
    {
        "lab/bench/singular_shapes.py",
        "execution/greedy_rule.py",
        "execution/belief.py",
        "execution/simulation/plant.py",
        "planning/greedy.py",
    }
)


@functools.cache
def tree(module: str) -> ast.Module:
    return ast.parse((PACKAGE / module).read_text())


@functools.cache
def imports(module: str) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            names += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.append(node.module)
    return tuple(names)


@functools.cache
def all_imports() -> list[tuple[str, str]]:
    return [(module, name) for module in MODULES for name in imports(module)]


def stage(module: str) -> int:
    found = [
        (len(name), i)
        for i, names in enumerate(STAGES)
        for name in names
        if module.startswith(name)
    ]
    assert found, f"{module} belongs to no stage"
    return max(found)[1]  # the longest name is the nearest one


def test_libraries_stay_behind_their_seam() -> None:
    for module, name in all_imports():
        places = ALLOWED.get(name.split(".")[0])
        assert places is None or module.startswith(places), f"{module} imports {name}"


def test_the_flow_has_one_direction() -> None:
    for module, name in all_imports():
        if name.startswith("twosra_mpc.") and (module, name) not in AGAINST_THE_FLOW:
            path = name.removeprefix("twosra_mpc.").replace(".", "/")
            target = f"{path}.py" if (PACKAGE / f"{path}.py").exists() else f"{path}/"
            assert stage(target) <= stage(module), f"{module} imports {name}"


@pytest.mark.parametrize("module", CERTIFICATES)
def test_certificates_are_checked_without_the_planner(module: str) -> None:
    own = {name for name in imports(module) if name.startswith("twosra_mpc.")}
    assert own
    assert all(name.startswith(OF_CERTIFICATES) for name in own), own
    code = f"import sys, {'twosra_mpc/' + module[:-3]}".replace("/", ".")
    loaded = "print(*(n for n in sys.modules if n.startswith(('twosra_mpc', 'casadi', 'scipy'))))"
    run = [sys.executable, "-c", f"{code}; {loaded}"]
    names = subprocess.run(run, capture_output=True, text=True, check=True).stdout.split()
    assert "twosra_mpc.robot.description" in names
    strange = ("casadi", "scipy", "twosra_mpc.planning", "twosra_mpc.model", "twosra_mpc.timing")
    assert not [n for n in names if n.startswith((*strange, "twosra_mpc.thermal.least_times"))]


def test_bounds_and_search_know_neither_the_model_nor_a_solver() -> None:
    unknown = "twosra_mpc.planning.solver", "twosra_mpc.planning.stages", "twosra_mpc.model"
    for module in MODULES:
        if module.startswith(("planning/bounds/", "planning/search/")):
            assert not any(name.startswith(unknown) for name in imports(module))


def uses_casadi_values(module: str) -> bool:
    """Whether it turns results of CasADi functions into arrays: ``x.full()``."""
    return any(
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "full"
        and not node.args  # numpy.full has some
        for node in ast.walk(tree(module))
    )


def test_values_of_casadi_stay_where_casadi_is() -> None:
    found = {
        module
        for module in MODULES
        if uses_casadi_values(module) and not module.startswith(ALLOWED["casadi"])
    }
    assert found == CASADI_VALUES_OUTSIDE


def choices(module: str) -> Iterator[str]:
    """Kinds of a thing: goal sets, and classes with a tag (``model: Literal["arc"]``) with it."""
    for node in tree(module).body:
        if isinstance(node, ast.ClassDef):
            found = list(tags(node))
            if found or "GoalSet" in map(ast.unparse, node.bases):
                yield from (node.name, *found)


def tags(node: ast.ClassDef) -> Iterator[str]:
    """Values of the ``Literal`` annotations of a class."""
    for item in ast.walk(node):
        if isinstance(item, ast.Subscript) and ast.unparse(item.value) == "Literal":
            given = ast.literal_eval(item.slice)
            yield from given if isinstance(given, tuple) else (given,)


@functools.cache
def asked_for(module: str) -> frozenset[str]:
    """Names of classes and texts that a module tests a value against."""
    return frozenset(_asked_for(module))


def _asked_for(module: str) -> Iterator[str]:
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            kinds = node.args[1]
            yield from (item.id for item in ast.walk(kinds) if isinstance(item, ast.Name))
        elif isinstance(node, ast.MatchClass):
            yield ast.unparse(node.cls)
        elif isinstance(node, ast.Compare) and ast.unparse(node.left).endswith((".model", ".path")):
            yield from (
                item.value
                for item in ast.walk(node)
                if isinstance(item, ast.Constant) and isinstance(item.value, str)
            )


def test_what_is_chosen_among_is_open() -> None:
    found = set()
    for home, places in OPEN_RECORDS.items():
        names = set(choices(home))
        assert names
        for module in MODULES:
            if not module.startswith(places):
                found |= {(module, name) for name in names & asked_for(module)}
    assert not found


def test_folders_do_not_import_each_other_in_a_circle() -> None:
    graph: dict[str, set[str]] = {}  # each folder by itself, inner ones too
    for module in MODULES:
        folder, _, name = module.rpartition("/")
        if name == "__init__.py" or not folder:  # what only offers names from elsewhere
            continue
        for imported in imports(module):
            if imported.startswith("twosra_mpc.") and (module, imported) not in AGAINST_THE_FLOW:
                path = imported.removeprefix("twosra_mpc.").replace(".", "/")
                target = path if (PACKAGE / path).is_dir() else path.rpartition("/")[0]
                graph.setdefault(folder, set()).update({target} - {folder, ""})
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError


def test_records_are_copied_with_validation() -> None:
    """``model_copy`` and ``model_construct`` accept what no file may say; ``with_values`` asks."""
    for module in MODULES:
        used = {node.attr for node in ast.walk(tree(module)) if isinstance(node, ast.Attribute)}
        assert not used & {"model_copy", "model_construct"}, module


def test_no_number_is_printed_as_minus_zero() -> None:
    """Each format of a float says "z" (PEP 682); templates have a filter that does."""
    for path in (*PACKAGE.rglob("*.py"), *(PACKAGE.parent / "benchmarks").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FormattedValue) and node.format_spec:
                form = ast.unparse(node.format_spec)[2:-1]
                assert "z" in form or form[-1] not in "eEfFgG%}", f"{path}:{node.lineno}: {form}"
    for path in (*PACKAGE.rglob("*.html"), *(PACKAGE.parent / "benchmarks").rglob("*.md")):
        assert "| format(" not in path.read_text(), path


def test_the_top_level_stays_small() -> None:
    assert len([module for module in MODULES if "/" not in module]) <= TOP_LEVEL_MODULES


# Size that the package has reached. A change that needs more says here what for.
# 268 lines and a file prove the bounds of missions anew, what tasks ask being read there for a
# second time.
# 450 and three files plan for joint bends that end elsewhere, with a proved bound; 200 are the
# limit of singular shapes, in plans, bounds and checks, 300 and two files the ways past them, the
# proofs that there are none, and the room that a unit needs. 190 and a file are drives that turn,
# 26 keep the memory of proofs small, 60 in the loop tell when metal has coasted long enough, and
# 40 plan as if no obstacle were there. 150 are drives that turn in missions and among obstacles.
# 590 and three files are the task that follows a path, with its check by other code and what a run
# that is pushed away does; 250 and 30 of tests find ways by balls of free poses, in maps of
# hundreds of polygons and along outlines that are rough, which had no plan. 360 lead objects along
# paths: by where they are seen, in the room of their cage or by friction, at given times, with how
# far off they were; 110 of them, and 145 of tests, are logs, bags and words of the same. 180 choose
# headings that wheels can pull in, and tell how late runs are and how unequally they slip; in fast
# metal bounds tell plans that turn left from those that turn right.
# 140 and 60 of tests drive to paths that begin elsewhere, choose how objects are carried to them
# and how they are touched, and know the lag of motors; 60 and 60 plan policies among obstacles,
# 25 end looks once they are decided. 230 prove how long fast metal moves by one function of heading
# and shape; 50 keep what is pushed within its cone and tell what bend a cusp may be; 35 know how
# firmly wheels hold a bend, so that no sensor is blamed for a shape that nothing bends.
# 90 prove the motion of each phase by functions of its own, with the ramps of drives and bends; 50
# and 60 of tests judge unequal bends at rest, close hands within the accuracy, and know what a
# distance may be off by; 15 and 65 of tests plan four segments.
MOST_CORE_LINES, MOST_CORE_FILES = 29_851, 199
MOST_LINES = 39_386
MOST_LINES_OF_TESTS = 32_796
MOST_FUNCTIONS_OF_A_PLAN, MOST_MODULES_OF_A_PLAN = 300, 46  # paper-1, planned once before


def code_lines(path: Path) -> int:
    """Lines of code: neither blank, nor comments, nor docstrings."""
    text = path.read_text()
    written = enumerate(map(str.strip, text.splitlines()), start=1)
    lines = {number for number, line in written if line and line[0] != "#"}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def test_the_package_does_not_grow() -> None:
    lines = {module: code_lines(PACKAGE / module) for module in MODULES}
    core = [count for module, count in lines.items() if not module.startswith("lab/")]
    assert len(core) <= MOST_CORE_FILES
    assert sum(core) <= MOST_CORE_LINES
    assert sum(lines.values()) <= MOST_LINES


def test_the_tests_do_not_grow() -> None:
    assert sum(map(code_lines, Path(__file__).parent.rglob("*.py"))) <= MOST_LINES_OF_TESTS


def test_a_plan_does_not_pass_through_more_and_more_functions() -> None:
    """Functions of the package, and their modules, that planning a published problem calls."""
    problem, called = load_problem("paper-1"), set()
    plan(problem)

    def note(frame: FrameType, event: str, _argument: object) -> None:
        code = frame.f_code
        if event == "call" and "<" not in code.co_name:  # no lambdas, no comprehensions
            called.add((code.co_filename, code.co_qualname))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        plan(problem)
    finally:
        sys.setprofile(before)
    own = {each for each in called if each[0].startswith(str(PACKAGE))}
    assert len(own) <= MOST_FUNCTIONS_OF_A_PLAN
    assert len({file for file, _ in own}) <= MOST_MODULES_OF_A_PLAN


def dotted(module: str) -> str:
    return f"twosra_mpc.{module[:-3]}".replace("/", ".")


def loaded_by(module: str) -> set[str]:
    """Names of modules that are imported where this one is, not later within a function."""
    return {
        f"{node.module}.{alias.name}" if is_module(node, alias) else str(node.module)
        for node in tree(module).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_no_module_imports_itself_in_a_circle_and_no_name_stands_twice() -> None:
    own = {dotted(module) for module in MODULES}
    graph = {dotted(module): loaded_by(module) & own - {dotted(module)} for module in MODULES}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError
    names = Counter(module.rpartition("/")[2] for module in MODULES)
    assert {name for name, count in names.items() if count > 1} == {"__init__.py"}


def test_nothing_needs_an_extra_but_what_it_is_for() -> None:
    """Whoever has installed no extra can plan, verify, run and draw."""
    needing = {m for m in MODULES if EXTRAS & {name.split(".")[0] for name in loaded_by(m)}}
    while more := {m for m in MODULES if loaded_by(m) & set(map(dotted, needing))} - needing:
        needing |= more
    assert needing == WITH_EXTRAS


def is_module(node: ast.ImportFrom, alias: ast.alias) -> bool:
    path = f"{node.module}.{alias.name}".replace(".", "/")
    return (PACKAGE.parent / f"{path}.py").exists()
