"""Live devices: bytes of links are decoded to channels, events and figures for the browsers."""
