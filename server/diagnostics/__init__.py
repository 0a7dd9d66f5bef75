"""What the machine around the server must be like: what is checked of it, and files that make it so."""
