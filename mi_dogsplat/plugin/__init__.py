"""What the integrator `dogsplat` and the shape `dog` need of Mitsuba: sensors, samples, film, background, surfaces."""
