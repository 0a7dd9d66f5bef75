"""Routes of computed signals: their definitions, and what an expression may consist of."""

from pydantic import BaseModel, Field

from imuscope.protocols.schema.units import SYMBOLS
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.derived_channels import DerivedChannels
from imuscope.server.extensions.analysis.expressions.expression_functions import FUNCTIONS
from imuscope.server.library.signal_definitions import MAX_NAME, MAX_TEXT, SignalDefinition

router = lazy_router(tags=["signals"])


class ExpressionFunction(BaseModel):
    """A function that expressions may use."""

    name: str
    form: str = Field(description="as typed, with its arguments")
    doc: str


class ExpressionWords(BaseModel):
    """Words that expressions may consist of, besides signals and numbers."""

    functions: list[ExpressionFunction]
    units: list[str]


class ComputedSignal(BaseModel):
    """A computed signal of a live device."""

    name: str = Field(description="of its channel")
    expression: str
    unit: str = Field(description='"" while it is not being computed')
    message: str = Field(description='why it is not being computed; "" if it is')
    hint: str


class SignalText(BaseModel, extra="forbid"):
    """The definition of a computed signal."""

    expression: str = Field(min_length=1, max_length=MAX_TEXT)


@router.get("/api/signals/words")
async def list_words() -> ExpressionWords:
    """Functions and units of expressions, for completion."""
    functions = [ExpressionFunction(name=name, form=one.form, doc=one.doc) for name, one in FUNCTIONS.items()]
    return ExpressionWords(functions=functions, units=list(SYMBOLS))


@router.get("/api/devices/{device}/signals", responses=responses(404, 422))
async def list_signals(device: str, services: TheServices) -> list[ComputedSignal]:
    """Computed signals of a device."""
    info = services.parts.get(DerivedChannels).device(device)
    return [_shown(device, one, services) for one in services.parts.get(DerivedChannels).definitions.of(info)]


@router.put("/api/devices/{device}/signals/{name}", responses=responses(404, 409, 422, 507))
async def put_signal(device: str, name: str, body: SignalText, services: TheServices) -> ComputedSignal:
    """Compute a signal as a channel of the device, also after a restart, in place of the one of that name."""
    definition = SignalDefinition(name[: MAX_NAME + 1], body.expression)
    services.parts.get(DerivedChannels).put(services.parts.get(DerivedChannels).device(device), definition)
    return _shown(device, definition, services)


@router.delete("/api/devices/{device}/signals/{name}", status_code=204, responses=responses(404, 409, 422, 507))
async def delete_signal(device: str, name: str, services: TheServices) -> None:
    """Remove a computed signal with its channel; refused while other signals use it."""
    services.parts.get(DerivedChannels).remove(services.parts.get(DerivedChannels).device(device), name)


def _shown(device: str, definition: SignalDefinition, services: TheServices) -> ComputedSignal:
    problem = services.parts.get(DerivedChannels).problem(device, definition.name)
    message, hint = (problem.message, problem.hint) if isinstance(problem, DomainError) else ("", "")
    unit = services.parts.get(DerivedChannels).unit(device, definition.name)
    return ComputedSignal(name=definition.name, expression=definition.expression, unit=unit, message=message, hint=hint)
