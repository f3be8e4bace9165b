"""McNab & Tsao: receding-horizon LQ contour tracking."""
