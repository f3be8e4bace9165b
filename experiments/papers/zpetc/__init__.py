"""Smith & Lee: zero phase error tracking, with an integrator and adaptive."""
