"""Where the parts of machines are: kinematics that several layers need, without units of any instrument."""
