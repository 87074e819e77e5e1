"""Configuration: site.yaml, its checks, the site folder, and public files that it names."""
