"""Many designs at once, over the devices of this computer."""
