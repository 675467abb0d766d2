"""Reading photographs: files of any kind and size, their place on the ground, and which pixels hold data."""
