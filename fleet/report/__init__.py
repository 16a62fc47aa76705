"""Reports: what came out of an evaluation, as a page with figures."""
