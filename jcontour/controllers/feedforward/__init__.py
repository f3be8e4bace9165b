"""What is sent ahead of the feedback: from models, and from models that adapt."""
