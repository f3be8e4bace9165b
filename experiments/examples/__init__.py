"""Scripts of one page, one idea each: copy one and change it."""
