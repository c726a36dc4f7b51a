"""exam.html, the blind benchmark of the diagnosis. Entry point: `files`, from `tables` through `page`."""
