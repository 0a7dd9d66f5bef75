"""The program as a whole, with all of its extensions."""
