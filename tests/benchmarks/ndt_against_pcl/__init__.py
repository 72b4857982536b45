"""Our NDT beside PCL's."""
