"""A support bundle: what a supporter needs to know of a site, without its secrets and without names of people."""
