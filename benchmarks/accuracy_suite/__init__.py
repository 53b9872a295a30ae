"""How accurate the results are: shapes with a known answer, measures, and the table of both."""
