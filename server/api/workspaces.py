"""Routes of workspaces: layouts of the page, stored by name."""

import asyncio
from typing import Annotated, Any

from fastapi import Header, Response
from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.library.workspaces import ANY, StoredWorkspace

router = lazy_router(prefix="/api", tags=["workspaces"])

IfMatch = Annotated[str | None, Header(description="revision that is replaced, as ETag; `*`: any")]


class WorkspaceInfo(BaseModel):
    """Name, revision and time of a stored workspace, without its content."""

    name: str
    modified: float = Field(description="unix seconds")
    revision: str = Field(description="changes with every change; also the ETag")


class WorkspaceBody(WorkspaceInfo):
    """A stored workspace with its content."""

    workspace: dict[str, Any] = Field(description="format, version and parts, as the page exports it")


class WorkspaceList(BaseModel):
    """All workspaces, and the one that devices of a family open with."""

    workspaces: list[WorkspaceInfo]
    defaults: dict[str, str] = Field(description="name of a workspace by protocol family")


class SaveWorkspaceRequest(BaseModel):
    """Content to store under the name of a workspace."""

    workspace: dict[str, Any] = Field(description="format, version and parts, as the page exports it")


class DefaultWorkspaceRequest(BaseModel):
    """Choice of the workspace in which devices of a family open."""

    name: str | None = Field(description="null: the page's own layout")


@router.get("/workspaces", responses=responses(422))
async def list_workspaces(services: TheServices) -> WorkspaceList:
    """Workspaces by name, and the default of each family."""
    store = services.workspaces
    stored = await asyncio.to_thread(store.all)
    return WorkspaceList(workspaces=[_info(one) for one in stored], defaults=await asyncio.to_thread(store.defaults))


@router.get("/workspaces/{name}", responses=responses(404, 422))
async def get_workspace(name: str, services: TheServices, response: Response) -> WorkspaceBody:
    """A workspace with its content."""
    return _body(await asyncio.to_thread(services.workspaces.get, name), response)


@router.put("/workspaces/{name}", responses=responses(404, 409, 412, 413, 422, 507))
async def save_workspace(
    name: str, body: SaveWorkspaceRequest, services: TheServices, response: Response, if_match: IfMatch = None
) -> WorkspaceBody:
    """Store a workspace. With `If-Match` it replaces that revision; without, there must be none of that name."""
    stored = await asyncio.to_thread(services.workspaces.put, name, body.workspace, _revision(if_match))
    return _body(stored, response)


@router.delete("/workspaces/{name}", status_code=204, responses=responses(404, 412, 422, 507))
async def delete_workspace(name: str, services: TheServices, if_match: IfMatch = None) -> Response:
    """Delete a workspace; with `If-Match` only that revision."""
    await asyncio.to_thread(services.workspaces.delete, name, _revision(if_match) or ANY)
    return Response(status_code=204)


@router.put("/workspace-defaults/{family}", responses=responses(404, 422, 507))
async def set_default_workspace(family: str, body: DefaultWorkspaceRequest, services: TheServices) -> dict[str, str]:
    """Set the workspace that devices of a protocol family open with. Answers with those of all families."""
    return await asyncio.to_thread(services.workspaces.set_default, family, body.name)


def _info(stored: StoredWorkspace) -> WorkspaceInfo:
    return WorkspaceInfo(name=stored.name, modified=stored.modified, revision=stored.revision)


def _body(stored: StoredWorkspace, response: Response) -> WorkspaceBody:
    response.headers["etag"] = f'"{stored.revision}"'
    return WorkspaceBody(**_info(stored).model_dump(), workspace=stored.workspace)


def _revision(if_match: str | None) -> str | None:
    return if_match and (if_match.strip().removeprefix("W/").strip('"') or ANY)
