"""Requirements on the host: checks, and configuration files that satisfy them."""
