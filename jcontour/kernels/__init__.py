"""Fast forms of what the library also says in readable form; each is tested equal to that."""
