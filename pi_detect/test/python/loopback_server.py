"""A file server on the loopback device that can be told to misbehave; for tests."""

import contextlib
import http.server
import threading


class LoopbackServer:
    """Serves the bytes in `files` (path -> content).

    `faults` is a list of functions that answer the next requests in place of the server: each is called once with the
    request handler and the content. `requests` lists (path, Range header or None) in order.
    """

    def __init__(self):
        self.files, self.faults, self.requests = {}, [], []
        self.ranges = True
        server = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                with contextlib.suppress(ConnectionError):  # a client may leave when it likes
                    server._answer(self)

            def log_message(self, *_):
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = False
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))  # [s], looks for close()
        self._thread.start()

    def url(self, path=""):
        return f"http://127.0.0.1:{self._server.server_port}{path}"

    def close(self):
        """Returns when all requests are answered."""
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def _answer(self, request):
        asked = request.headers.get("Range")
        self.requests.append((request.path, asked))
        content = self.files.get(request.path)
        if content is None:
            request.send_error(404)
        elif self.faults:
            self.faults.pop(0)(request, content)
        else:
            serve(request, content, asked if self.ranges else None)


def serve(request, content, asked):
    """Answers with all of the content, or with the part that a Range header asks for."""
    begin = int(asked.split("=")[1].split("-")[0]) if asked else 0
    if asked and begin >= len(content):
        request.send_response(416)
        request.send_header("Content-Range", f"bytes */{len(content)}")
        request.send_header("Content-Length", "0")
        request.end_headers()
        return
    request.send_response(206 if asked else 200)
    if asked:
        request.send_header("Content-Range", f"bytes {begin}-{len(content) - 1}/{len(content)}")
    request.send_header("Content-Length", str(len(content) - begin))
    request.end_headers()
    request.wfile.write(content[begin:])


def cut_after(count):
    """A fault: promises all, closes the connection after so many bytes."""
    def fault(request, content):
        asked = request.headers.get("Range")
        begin = int(asked.split("=")[1].split("-")[0]) if asked else 0
        request.send_response(206 if asked else 200)
        if asked:
            request.send_header("Content-Range", f"bytes {begin}-{len(content) - 1}/{len(content)}")
        request.send_header("Content-Length", str(len(content) - begin))
        request.end_headers()
        request.wfile.write(content[begin:begin + count])
        request.close_connection = True
    return fault


def fail(status):
    """A fault: an error of the server."""
    return lambda request, _: request.send_error(status)
