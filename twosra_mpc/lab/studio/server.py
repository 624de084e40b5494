"""The local server of the studio: one page, and messages in JSON, on this computer alone.

One thread does all planning and all runs, in turn. Who closes a connection has given up: the work
for it ends within a few units. Every request needs the token that is part of the page's address,
a Host of this computer, and no foreign Origin.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any, TypeVar

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError, TwosraError, printable
from twosra_mpc.execution.simulation.disturbance import LEVELS
from twosra_mpc.execution.simulation.plant import ALL_PLANTS
from twosra_mpc.files import built_in_names, data_file, environment, plain_data
from twosra_mpc.installation import require
from twosra_mpc.lab.report.page import policy
from twosra_mpc.lab.studio.answers import Ask, GivenUp, Saved, answers, document, saved, scene
from twosra_mpc.lab.studio.goal_map import goal_coordinates, goal_map
from twosra_mpc.lab.studio.live import LiveRun, Push, Run
from twosra_mpc.problem.problem import Problem, load_problem
from twosra_mpc.robot.paths import PATH_MODELS
from twosra_mpc.validation import Several, Value

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

_LARGEST = 1_000_000  # bytes of a message
_HOSTS = ("127.0.0.1", "localhost")
_FRAME_S = 0.05  # between two frames of a run that are shown

_NO_ANSWER = "scene", "run", "ranges"  # kinds of records that come before any work

Record = dict[str, Any]
Message = TypeVar("Message", bound=Value)
Work = Callable[[GivenUp], Iterator[Record]]


class MapAsked(Value):
    """Request of a map: a problem as scenario document, and two coordinates of its goal."""

    problem: dict[str, Any]
    over: Several[str]


@public
class Server:
    """A server of the studio on a port of this computer.

    Attributes:
        address: Of the page, with the token.
    """

    def __init__(self, problem: Problem, port: int = 0, name: str = "") -> None:
        """Listen, and show this problem first.

        Args:
            problem: The problem.
            port: The port; 0 takes a free one.
            name: Of the problem; the tab has it, too.

        Raises:
            InputError: If the extra is not installed, or the port is taken.
        """
        require("the studio", "studio", "starlette", "uvicorn")
        self._problem, self._name = problem, name or problem.description
        self._token = secrets.token_urlsafe(16)
        self._socket = socket.socket()
        try:
            self._socket.bind((_HOSTS[0], port))
            self._socket.listen()  # who comes before the server is ready waits
        except OSError as error:
            self._socket.close()
            raise InputError("--port", port, f"a free port: {error.strerror}") from None
        self._port = self._socket.getsockname()[1]
        self.address = f"http://{_HOSTS[0]}:{self._port}/?token={self._token}"
        self._runs = dict[str, LiveRun]()
        self._unanswered = set[threading.Event]()  # those who wait for a first answer
        self._worker = ThreadPoolExecutor(1, "studio")
        self._app = self._make_app()

    def serve(self) -> None:
        """Serve until Ctrl-C."""
        import uvicorn

        settings: Record = {"log_level": "critical", "timeout_graceful_shutdown": 1}
        with suppress(KeyboardInterrupt):
            uvicorn.Server(uvicorn.Config(self._app, **settings)).run(sockets=[self._socket])
        self.close()

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()
        self._worker.shutdown(cancel_futures=True)

    def serve_in_background(self) -> threading.Thread:
        """Serve from a thread that ends with the program."""
        thread = threading.Thread(target=self.serve, name="studio server", daemon=True)
        thread.start()
        return thread

    def _make_app(self) -> Starlette:
        from starlette.applications import Starlette
        from starlette.routing import Route

        routes = [Route("/", self._page)]
        for name in ("alive", "plan", "map", "run", "push", "save", "open"):
            answer = self._guarded(getattr(self, f"_{name}"))
            routes.append(Route(f"/{name}", answer, methods=["POST"]))
        return Starlette(routes=routes)

    # Who may ask.

    def _refusal(self, request: Request, token: str | None) -> str | None:
        """Reason for refusing a request; None if it is answered."""
        hosts = {f"{host}:{self._port}" for host in _HOSTS}
        if request.headers.get("host") not in hosts:
            return "this server answers this computer only"
        origin = request.headers.get("origin")
        if origin is not None and origin.removeprefix("http://") not in hosts:
            return "another page asked"
        if not secrets.compare_digest(token or "", self._token):
            return "the token of the address is missing or wrong"
        return None

    def _guarded(self, answer: Callable[[Record], Any]) -> Callable[[Request], Any]:
        from starlette.responses import JSONResponse

        async def guarded(request: Request) -> Response:
            if (why := self._refusal(request, request.headers.get("x-token"))) is not None:
                return JSONResponse(_refused(why), 403)
            text = bytearray()
            async for part in request.stream():
                if len(text) <= _LARGEST:
                    text += part
            if len(text) > _LARGEST:
                return JSONResponse(_refused("a message of more than a megabyte"), 413)
            try:
                given = json.loads(text)
                if not isinstance(given, dict):
                    raise InputError("message", type(given).__name__, "a JSON object")
                found: Response = await answer(given)
            except (ValueError, RecursionError, TwosraError) as error:
                return JSONResponse(_told(error), 400)
            return found

        return guarded

    # What is answered.

    async def _page(self, request: Request) -> Response:
        from starlette.responses import HTMLResponse, PlainTextResponse

        if (why := self._refusal(request, request.query_params.get("token"))) is not None:
            return PlainTextResponse(why, 403)
        style = data_file("lab/report/page.css") + data_file("lab/studio/studio.css")
        script = data_file("lab/report/player.js") + data_file("lab/studio/studio.js")
        known = {
            "token": self._token,
            "name": self._name,
            "problem": document(self._problem),
            "scenarios": built_in_names("scenarios"),
            "robots": built_in_names("robots"),
            "path_models": list(PATH_MODELS),
            "plants": list(ALL_PLANTS),
            "levels": list(LEVELS),
        }
        only = f"{policy(style, script)}; connect-src 'self'"
        page = environment("lab/studio").get_template("studio.html")
        text = page.render(style=style, script=script, policy=only, known=known)
        return HTMLResponse(text, headers={"Cache-Control": "no-store"})

    async def _alive(self, given: Record) -> Response:
        from starlette.responses import JSONResponse

        del given
        return JSONResponse({"kind": "alive"})

    async def _plan(self, given: Record) -> Response:
        ask = Ask(**given)
        return self._stream(lambda given_up: answers(ask, given_up, lambda: bool(self._unanswered)))

    async def _map(self, given: Record) -> Response:
        asked = MapAsked(**given)

        def cells(given_up: GivenUp) -> Iterator[Record]:
            problem = Problem(**asked.problem)
            ranges = goal_coordinates(problem)
            yield {"kind": "ranges", "over": asked.over, "ranges": ranges}
            for cell in goal_map(problem, asked.over):
                if given_up():
                    return
                yield {"kind": "cell", **cell._asdict()}

        return self._stream(cells)

    async def _run(self, given: Record) -> Response:
        run, number = LiveRun(Run(**given)), secrets.token_hex(4)

        def frames(given_up: GivenUp) -> Iterator[Record]:
            self._runs[number] = run
            try:
                yield {"kind": "run", "run": number}
                with closing(run.frames()) as steps:
                    yield from _paced(steps, run.asked.speed)
            finally:
                del self._runs[number]

        return self._stream(frames)

    async def _push(self, given: Record) -> Response:
        from starlette.responses import JSONResponse

        run = self._runs.get(str(given.pop("run", "")))
        if run is None:
            raise InputError("run", None, "a run that is on its way")
        run.pushes.append(Push(**given))
        return JSONResponse({"kind": "pushed"})

    async def _save(self, given: Record) -> Response:
        asked = Saved(**given)
        return await self._once(lambda: saved(asked))

    async def _open(self, given: Record) -> Response:
        name = given.get("scenario")
        if name not in built_in_names("scenarios"):
            raise InputError("scenario", name, "the name of a built-in scenario")
        return await self._once(lambda: scene(load_problem(str(name))))

    # How the work is done.

    async def _once(self, work: Callable[[], Record]) -> Response:
        from starlette.responses import JSONResponse

        done = await asyncio.get_running_loop().run_in_executor(self._worker, work)
        return JSONResponse(plain_data(done))

    def _stream(self, work: Work) -> Response:
        """Records, a line of JSON each, as they are made; work ends where nobody reads on.

        One that is early is held back.
        """
        from starlette.responses import StreamingResponse

        async def lines() -> AsyncIterator[bytes]:
            loop, over = asyncio.get_running_loop(), threading.Event()
            records = work(over.is_set)
            self._unanswered.add(over)
            try:
                while True:
                    record = await loop.run_in_executor(self._worker, _next, records)
                    if record is None:
                        return
                    if record["kind"] not in _NO_ANSWER:
                        self._unanswered.discard(over)
                    await asyncio.sleep(record.get("early_s", 0.0))
                    yield json.dumps(plain_data(record), allow_nan=False).encode() + b"\n"
            finally:
                over.set()
                self._unanswered.discard(over)
                self._worker.submit(_closed, records)

        return StreamingResponse(lines(), media_type="application/x-ndjson")


def _next(records: Iterator[Record]) -> Record | None:
    """The next record; None at the end. What goes wrong is a record too."""
    try:
        return next(records, None)
    except Exception as error:
        return _told(error)


def _closed(records: Any) -> None:
    records.close()


def _told(error: Exception) -> Record:
    """Error in words, with the field that is wrong."""
    if isinstance(error, InputError):
        return {**_refused(str(error)), "field": error.field}
    if isinstance(error, TwosraError | ValueError | RecursionError | OSError):
        return _refused(str(error))
    return _refused(f"this is a bug ({printable(f'{type(error).__name__}: {error}')})")


def _refused(words: str) -> Record:
    return {"kind": "refused", "message": words}


def _paced(steps: Iterator[Record], speed: float) -> Iterator[Record]:
    """Frames of a run that are worth showing, each with how long it is early."""
    began_s = shown_s = time.monotonic()
    events, plan = list[Any](), None
    for frame in steps:
        events += frame["events"]
        plan = frame["plan"] or plan
        now_s = time.monotonic()
        early_s = began_s + frame["time_s"] / speed - now_s
        if max(early_s, now_s - shown_s) > _FRAME_S or frame["ended"]:
            shown_s = now_s
            yield {**frame, "events": events, "plan": plan, "early_s": max(0.0, early_s)}
            events, plan = [], None


@public
def widget(problem: Problem, height: int = 900) -> Any:
    """Show the studio with a problem in a notebook; its server ends with the notebook.

    Args:
        problem: The problem.
        height: Of the frame [pixels].

    Raises:
        InputError: If the extra is not installed.
    """
    require("widget", "studio", "starlette", "uvicorn", "IPython")
    from IPython.display import IFrame

    server = Server(problem)
    server.serve_in_background()
    return IFrame(server.address, "100%", height)
