"""From a scan as its file gives it to one in metres with z up: units, axes, levels, outliers, meshes."""
