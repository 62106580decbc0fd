"""What pi_edge open prints."""

import socket
import threading
import unittest

from pi_bringup import web_page


class WebPage(unittest.TestCase):
    def test_addresses_for_this_computer_and_for_others(self):
        self.assertEqual(["http://127.0.0.1:8890/"], web_page.addresses("http://127.0.0.1:8890/", "", ["10.0.0.7"]))
        self.assertEqual(["http://127.0.0.1:80/?token=x", "http://10.0.0.7:80/?token=x"],
                         web_page.addresses("http://0.0.0.0:80/", "x", ["127.0.0.1", "10.0.0.7"]))
        self.assertEqual(["http://[::1]:80/"], web_page.addresses("http://[::1]:80/", "", []))

    def test_only_a_server_that_answers_counts(self):
        with socket.create_server(("127.0.0.1", 0)) as server:
            url = "http://127.0.0.1:%d/" % server.getsockname()[1]
            for answer, right in ((b"HTTP/1.0 200 OK\r\n\r\n", True), (b"HTTP/1.0 404 Not\r\n\r\n", False)):
                def serve(answer=answer):
                    connection, _ = server.accept()
                    with connection:
                        connection.recv(1000)
                        connection.sendall(answer)
                thread = threading.Thread(target=serve)
                thread.start()
                self.assertEqual(right, web_page.answers(url))
                thread.join()
        self.assertFalse(web_page.answers(url))


if __name__ == "__main__":
    unittest.main()
