"""Configuration: reads and checks site.yaml, the site folder and the public files that site.yaml names."""
