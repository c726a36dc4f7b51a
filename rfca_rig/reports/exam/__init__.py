"""exam.html, the blind benchmark of the diagnosis. Entry point: `page.write_exam`, from
`tables`.
"""
