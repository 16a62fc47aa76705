"""`unspoken run` and `unspoken simulate`: one run, in processes or in virtual time."""
