"""What is written of a job afterwards: a report as one HTML page, and its records as tables.

Read `report` first: it gathers everything about a job and renders the page from `report.html.j2`, with the figures that
`figures` draws. `records` fetches a job's records page by page, and writes them as CSV or Parquet.
"""
