"""Routes of device commands: the command tables, for programs that draw their own forms or documentation."""

from __future__ import annotations

import asyncio
from functools import lru_cache

from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import Forms
from imuscope.server.configuration.form_builder import all_forms

router = lazy_router(prefix="/api", tags=["forms"])

_tables = lru_cache(maxsize=1)(all_forms)


@router.get("/commands")
async def get_commands() -> list[Forms]:
    """Every command and setting of every protocol, all products together; GET …/forms has those of one device."""
    return await asyncio.to_thread(_tables)
