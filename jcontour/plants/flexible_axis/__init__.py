"""A linear motor that moves an end effector on a spring."""
