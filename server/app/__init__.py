"""The application: routes, guards and services put together. Begin with build.py. Imported by commands only."""
