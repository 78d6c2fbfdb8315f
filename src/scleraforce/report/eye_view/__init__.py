"""The deformed eye in three dimensions, to be turned in a page: WebGL, no library, nothing fetched."""
