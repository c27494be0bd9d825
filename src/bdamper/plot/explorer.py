"""The page on the loopback interface, with a random token in its address."""

from __future__ import annotations

import asyncio
import secrets
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Thread
from typing import Any

from bdamper.study import Study
from bdamper.util import validation
from bdamper.util.errors import BdamperError, import_extra


@dataclass(frozen=True)
class Explorer:
    """A page that is being served; a notebook shows it.

    Parameters
    ----------
    address : str
        For a browser on this machine.
    pages : list of Page
        Of the windows that are open.
    """

    address: str
    pages: list[Any]
    _server: Any
    _thread: Thread

    def wait(self) -> None:
        """Serve until :meth:`close` or Ctrl-C."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """End the page."""
        self._server.io_loop.add_callback(self._server.io_loop.stop)
        self._thread.join(5.0)

    def __str__(self) -> str:
        return f"explorer at {self.address}"

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.address}" style="width:100%;height:860px;border:0"></iframe>'


def explore(study: Study, *, source: str = "# study: the one that is explored") -> Explorer:
    """A page with sliders for a study, its curves, contact faces and loops, on the loopback interface.

    Parameters
    ----------
    study : Study
    source : str
        Lines of Python that make the study, for those that the page shows.

    Returns
    -------
    Explorer
        Its ``address`` holds a random token, without which nothing is served; a notebook shows the page itself.

    Raises
    ------
    BdamperError
        If Bokeh is not installed (the extra ``bdamper[app]``).
    """
    validation.instance("study", study, Study)
    server, application, handlers, access, web = (
        import_extra(name, "explore", "app")
        for name in (
            "bokeh.server.server", "bokeh.application", "bokeh.application.handlers.function", "bokeh.server.auth_provider",
            "tornado.web",
        )
    )  # fmt: skip
    from bdamper.plot.explorer_page import Page  # which draws: matplotlib is loaded no earlier

    path, started = f"/{secrets.token_urlsafe(24)}", SimpleQueue[Any]()
    pages: list[Page] = []
    hosts: set[str] = set()

    class Loopback(access.NullAuth):  # type: ignore[misc, name-defined]
        """Refuse requests for another host, since any page can resolve its name to the loopback interface."""

        login_url = path

        async def get_user_async(self, request: Any) -> str:
            if request.request.host.lower() not in hosts:
                raise web.HTTPError(403)
            request.application.websocket_origins.update(hosts)
            return "user"

    def make(document: Any) -> None:
        pages[:] = [page for page in pages if not page.answers.closed]
        pages.append(Page(document, study, source))

    def serve() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            app = application.Application(handlers.FunctionHandler(make))
            found = server.Server(
                {path: app}, address="127.0.0.1", port=0, use_index=False, auth_provider=Loopback(),
                check_unused_sessions_milliseconds=1000,  # work ends soon after its window is closed
            )  # fmt: skip
            hosts.update(f"{name}:{found.port}" for name in ("localhost", "127.0.0.1"))
            found.start()
        except OSError as error:
            started.put(error)
            return
        started.put(found)
        found.io_loop.start()
        found.stop()
        for page in pages:
            page.answers.ask(None)

    thread = Thread(target=serve, daemon=True)
    thread.start()
    found = started.get()
    if isinstance(found, OSError):
        raise BdamperError(f"explore: expected a free port of the loopback interface, found {found}")
    return Explorer(f"http://localhost:{found.port}{path}", pages, found, thread)
