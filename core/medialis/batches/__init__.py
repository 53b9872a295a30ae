"""Many shapes: any operations over many files, on processes of this machine or of a cluster."""
