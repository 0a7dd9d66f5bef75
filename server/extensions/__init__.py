"""Extensions of the server, a folder each (server/services/extension.py). Nothing outside imports them."""
