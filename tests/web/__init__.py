"""The page from outside: its build, its extensions, and what its component tests are fed."""
