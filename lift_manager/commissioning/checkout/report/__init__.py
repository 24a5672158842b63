"""Reports of acceptance tests, for people to sign and for other programs."""
