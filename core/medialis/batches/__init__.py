"""Much at a time: operations over many files, and clouds that do not fit comfortably into memory.

`batch` takes files and operations, runs each file as a job in a worker process, and returns one
`Row` for each file and operation; beside them it writes a folder of results each, a table for
programs and a page for people. One bad shape never stops the rest, and a batch that was stopped
goes on where it ended. Read `batch.py` first: plan and table; then `jobs.py`, what is planned, what
counts as finished, and what a worker does; `engine.py` hands jobs out to processes of this machine
or to a Dask cluster, and knows nothing about shapes but the rows of those that died.
`huge.py` computes the balls of one huge cloud in files (thesis 3.2), with the same cluster.
Another column of the page or the table belongs into `batch.py`, and what it shows into `Row`.
"""
