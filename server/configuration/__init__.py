"""Device configuration: forms, jobs, the traffic log, snapshots and rollback."""
