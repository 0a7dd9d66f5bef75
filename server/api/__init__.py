"""The HTTP side: one file per noun, thin. What a route does lies elsewhere in `server`; here are shapes and words."""
