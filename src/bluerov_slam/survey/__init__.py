"""Many runs at once: the only package that knows of a cluster."""
