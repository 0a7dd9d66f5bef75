"""Routes that are built at their first request, each as FastAPI builds it."""

from __future__ import annotations

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute

from imuscope.server.api.framework import ROUTERS
from imuscope.server.api.lazy_routes import LazyRoute, lazy_router
from tests.support.asgi_client import send_request


def test_a_route_is_built_at_its_first_request() -> None:
    router = lazy_router(prefix="/api")

    @router.get("/{name}/double", responses={404: {"description": "unknown"}})
    async def double(name: str, times: int = 2) -> list[str]:
        """A list."""
        return [name] * times

    [route] = router.routes
    assert isinstance(route, LazyRoute)
    app = FastAPI()
    app.router.routes.extend(router.routes)
    assert send_request(app, "GET", "/api/double").status_code == 404
    assert send_request(app, "POST", "/api/x/double").status_code == 405
    assert "dependant" not in vars(route)
    assert send_request(app, "GET", "/api/x/double?times=3").body == b'["x","x","x"]'
    assert "dependant" in vars(route)
    assert send_request(app, "GET", "/api/x/double?times=many").status_code == 422
    assert route.description == "A list."
    assert set(app.openapi()["paths"]["/api/{name}/double"]["get"]["responses"]) == {"200", "404", "422"}
    with pytest.raises(AttributeError, match="nothing"):
        route.nothing  # noqa: B018 - as `hasattr` asks


def test_what_a_route_knows_before_is_what_it_knows_then() -> None:
    routes = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    assert len(routes) > 70
    for route in routes:
        assert isinstance(route, LazyRoute), route.path
        known = (route.name, route.methods, route.path_regex, route.path_format, route.param_convertors.keys())
        built = APIRoute(route.path, route.endpoint, response_model=None, methods=route.methods, name=route.name)
        assert known == (built.name, built.methods, built.path_regex, built.path_format, built.param_convertors.keys())
