"""Extensions of the server, a folder each (server/extension.py). Nothing outside imports them."""
