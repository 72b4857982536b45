"""Models that know their walls (IFC, Open-RMF, ROS maps) to plans."""
