"""Who does the work: this process, processes of this machine, workers of a cluster; all the same to whoever hands it out."""
