"""Live samples and states on their way to browsers: channels, the hub, ring buffers, send queues."""
