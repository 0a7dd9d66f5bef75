"""Products by name: is a profile of one meant for another?

    MTi-630-8A1G6, MTi-630-2A8G4     the same product in two versions of its hardware: MTi-630
    MTi-G-710-2A8G4                  MTi-G-710
    IMX-5.0.4                        IMX-5

Nothing here knows a family: a product is its leading letters and the first number behind them.
"""

from __future__ import annotations

import re

_NAME = re.compile(r"[A-Za-z][A-Za-z ]*-(?:[A-Za-z]-)?\d+[A-Za-z]*")


def base_name(product: str) -> str:
    """The product without the version of its hardware; the whole name where it is written otherwise."""
    found = _NAME.match(product.strip())
    return found[0] if found else product.strip()


def alike(one: str, other: str) -> bool:
    """Are two devices of the same product, as far as both are known?"""
    return not one or not other or base_name(one) == base_name(other)


def mismatch(profile: str, product: str) -> str:
    """What it means to write the profile of one product to another; "" where they are alike."""
    if alike(profile, product):
        return ""
    ours, theirs = base_name(product), base_name(profile)
    return (
        f"These settings are of “{theirs}”, this device is “{ours}”: outputs that only “{ours}” has are switched off."
    )
