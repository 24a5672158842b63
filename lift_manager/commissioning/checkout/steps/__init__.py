"""The procedures: what is done, asked and looked at for each kind of item. Without a terminal."""
