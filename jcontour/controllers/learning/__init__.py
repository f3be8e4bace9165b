"""What is learned from lap to lap: iterative learning, repetitive control, cancellation."""
