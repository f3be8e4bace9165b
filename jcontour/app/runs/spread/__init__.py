"""Many runs: over devices, hosts, and the processes of a cluster."""
