"""What is done to a device: forms, jobs, the exchange, snapshots, and the way back."""
