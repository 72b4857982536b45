"""The dashboard: files that are built from `app/` into `dist/`, and how a browser gets them."""
