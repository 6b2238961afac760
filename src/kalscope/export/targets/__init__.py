"""One module per export target, each with `files(job) -> dict of file name -> text`."""
