"""Arguments of the commands that serve a page: where, and over TLS."""

import argparse


def add_page_address(command: argparse.ArgumentParser) -> None:
    """Add --host, --port and the options of TLS."""
    command.add_argument(
        "--host", help="address to serve the page on (default 127.0.0.1; any other requires a token, which is printed)"
    )
    command.add_argument("--port", type=int, help="port of the page (default 8080; 0 selects a free port)")
    command.add_argument("--tls", action="store_true", default=None, help="serve HTTPS with a self-signed certificate")
    command.add_argument("--tls-cert", metavar="FILE", help="certificate to serve HTTPS with (PEM); requires --tls-key")
    command.add_argument("--tls-key", metavar="FILE", help="private key of --tls-cert (PEM, without a passphrase)")
