"""Server of the explorer page on the loopback interface, with a random token in its address."""

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
    """Running explorer page; a notebook displays it.

    Parameters
    ----------
    address : str
        URL for a browser on this computer.
    pages : list of Page
        Pages of the open windows.
    """

    address: str
    pages: list[Any]
    _server: Any
    _thread: Thread

    def wait(self) -> None:
        """Wait until :meth:`close` or Ctrl-C."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """Stop the server."""
        self._server.io_loop.add_callback(self._server.io_loop.stop)
        self._thread.join(5.0)

    def __str__(self) -> str:
        return f"explorer at {self.address}"

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.address}" style="width:100%;height:860px;border:0"></iframe>'


def explore(study: Study, *, source: str = "# study: the explored study") -> Explorer:
    """Serve a page with sliders for a study, its curves, contact faces and loops.

    Parameters
    ----------
    study : Study
    source : str
        Python code that creates the study, shown in the code of the page.

    Returns
    -------
    Explorer
        Its ``address`` contains a random token, which every request needs.  A notebook displays the
        page.

    Raises
    ------
    BdamperError
        If Bokeh is not installed (the extra ``bdamper[app]``).
    """
    validation.instance("study", study, Study)
    server = import_extra("bokeh.server.server", "explore", "app")
    application = import_extra("bokeh.application", "explore", "app")
    handlers = import_extra("bokeh.application.handlers.function", "explore", "app")
    access = import_extra("bokeh.server.auth_provider", "explore", "app")
    web = import_extra("tornado.web", "explore", "app")
    from bdamper.plot.explorer_page import Page  # imports matplotlib, which takes time

    path = f"/{secrets.token_urlsafe(24)}"
    # the running server, or the error that prevents it
    started = SimpleQueue[Any]()
    pages: list[Page] = []
    hosts: set[str] = set()

    class Loopback(access.NullAuth):  # type: ignore[misc, name-defined]
        """Refuse other hosts, since any website can resolve its name to the loopback interface."""

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
            running = server.Server(
                {path: app},
                address="127.0.0.1",
                port=0,
                use_index=False,
                auth_provider=Loopback(),
                check_unused_sessions_milliseconds=1000,  # the work for a closed window ends soon
            )
            hosts.update([f"localhost:{running.port}", f"127.0.0.1:{running.port}"])
            running.start()
        except OSError as error:
            started.put(error)
            return
        started.put(running)
        running.io_loop.start()
        running.stop()
        for page in pages:
            page.answers.ask(None)

    thread = Thread(target=serve, daemon=True)
    thread.start()
    running = started.get()
    if isinstance(running, OSError):
        raise BdamperError(
            f"explore: no port of the loopback interface could be opened ({running})"
        )
    return Explorer(f"http://localhost:{running.port}{path}", pages, running, thread)
