"""HTTP and WebSocket routes, one file per resource. Routes only check input and format answers; the work is done
elsewhere in `server`.
"""
