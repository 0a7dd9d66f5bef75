"""Supported products and data of the MTi, for the documentation."""

from collections.abc import Iterator

from imuscope.protocols.family.info import SupportTable
from imuscope.protocols.xbus.commands import commands, settings
from imuscope.protocols.xbus.output_configuration import ALWAYS, OUTPUTS, max_rate
from imuscope.protocols.xbus.products import MODELS, Model, has

KINDS = {"IMU": "IMU", "VRU": "VRU", "AHRS": "AHRS", "GNSS": "GNSS/INS", "RTK": "RTK GNSS/INS"}


def supported() -> Iterator[SupportTable]:
    """Products, then what they can send."""
    yield SupportTable(
        "Products",
        "The product is read from the device's product code. A product that is not in this list is offered every "
        "setting and command, and rejects those it does not support. An MTi-G-700 is treated as an MTi-G-710, and a "
        "rugged product (MTi-630R) as its plain form.",
        ("product", "series", "kind", "quantities", "settings", "commands"),
        tuple(_product(model) for model in MODELS.values()),
    )
    yield SupportTable(
        "Quantities of the output configuration",
        "All number formats (float32, float64, both fixed-point formats) and coordinate systems (ENU, NED, NWU) are "
        "supported. Further data identifiers of the document are decoded although none of these products sends them.",
        ("quantity", "data identifier", "unit", "largest rate, Hz", "products"),
        tuple(_output(identifier) for identifier in OUTPUTS),
    )


def _product(model: Model) -> tuple[str, ...]:
    outputs = sum(has(model, output.products) for output in OUTPUTS.values())
    counts = (outputs, len(settings(model.name)), len(commands(model.name)))
    return (model.name, f"{model.series}-series", KINDS[model.kind], *map(str, counts))


def _output(identifier: int) -> tuple[str, ...]:
    output = OUTPUTS[identifier]
    models = [model for model in MODELS.values() if has(model, output.products)]
    rates = sorted({max_rate(output, model) for model in models})
    rate = "every message" if output.hertz == ALWAYS else ", ".join(map(str, rates))
    names = "all" if len(models) == len(MODELS) else ", ".join(model.name for model in models)
    return (output.field.title or output.name, f"`0x{identifier:04X}`", output.field.unit, rate, names)
