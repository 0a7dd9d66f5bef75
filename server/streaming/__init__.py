"""Live samples and states on their way to browsers: channel store, bus, fan-out, send queues."""
