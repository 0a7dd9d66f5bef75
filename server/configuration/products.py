"""Comparison of products by name, to check whether a profile of one fits another.

    MTi-630-8A1G6, MTi-630-2A8G4     the same product in two hardware versions: MTi-630
    MTi-G-710-2A8G4                  MTi-G-710
    IMX-5.0.4                        IMX-5

The rule is the same for all families: a product is its leading letters and the first number after them.
"""

import re

_NAME = re.compile(r"[A-Za-z][A-Za-z ]*-(?:[A-Za-z]-)?\d+[A-Za-z]*")


def base_name(product: str) -> str:
    """The product without its hardware version; the whole name if it has another form."""
    match = _NAME.match(product.strip())
    return match[0] if match else product.strip()


def same_product(one: str, other: str) -> bool:
    """Whether two devices are the same product, as far as both are known."""
    return not one or not other or base_name(one) == base_name(other)


def mismatch(profile: str, product: str) -> str:
    """Effect of writing the profile of one product to another; "" if they are the same product."""
    if same_product(profile, product):
        return ""
    ours, theirs = base_name(product), base_name(profile)
    return (
        f"These settings are for “{theirs}”, this device is “{ours}”: outputs that only “{ours}” has are switched off."
    )
