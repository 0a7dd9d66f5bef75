"""Routes of uploads to the store of recordings (docs/fleet.md)."""

from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.extensions.fleet.upload.uploads import RecordingUpload, UploadService

router = lazy_router(prefix="/api/uploads", tags=["uploads"])


class UploadsState(BaseModel):
    """Uploads of this robot's recordings."""

    enabled: bool = Field(description="whether finished recordings are uploaded: `[store] upload = true`")
    store: str = Field(description="URL or folder; empty if none is uploaded")
    robot: str = Field(description="name of this robot in the store")
    problem: str = Field(description="why the last attempt failed, if the store cannot be used; it is tried again")
    recordings: list[RecordingUpload] = Field(description="finished recordings, in the order of the library")


@router.get("")
async def get_uploads(services: TheServices) -> UploadsState:
    """State of the uploads, of each finished recording."""
    uploads = services.parts.get(UploadService)
    return UploadsState(
        enabled=uploads.is_enabled,
        store=uploads.settings.url if uploads.is_enabled else "",
        robot=uploads.robot,
        problem=uploads.problem,
        recordings=await uploads.uploads(),
    )
