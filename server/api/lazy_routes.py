"""Routes that are built at their first request.

FastAPI builds the validators of a route when it is declared. For all routes of a server that took a sixth of its start
and 6 MB, while a page asks for a dozen of them.
"""

import functools
from collections.abc import Callable
from typing import Any

from fastapi import APIRouter
from fastapi.routing import APIRoute
from starlette.routing import compile_path, get_name


class LazyRoute(APIRoute):
    """A route with its path and methods, built on the event loop when another attribute is needed."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **declared: Any) -> None:
        self.path, self.endpoint, self._declared = path, endpoint, declared
        self.name = declared.get("name") or get_name(endpoint)
        self.methods = {method.upper() for method in declared.get("methods") or ["GET"]}
        self.path_regex, self.path_format, self.param_convertors = compile_path(path)

    def __getattr__(self, name: str) -> Any:
        declared = self.__dict__.pop("_declared", None)
        if declared is None:
            raise AttributeError(name)
        super().__init__(self.path, self.endpoint, **declared)
        return getattr(self, name)


lazy_router = functools.partial(APIRouter, route_class=LazyRoute)
