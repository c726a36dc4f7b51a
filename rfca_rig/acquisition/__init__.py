"""Reading a fast sensor in a process of its own, so that nothing this process does can make it miss a record."""
