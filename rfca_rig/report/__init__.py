"""Reports that compare recordings with the model: a page for people, tables for programs and papers. Entry point: `writing.write_report`.

`table2_page`, `run_page`, `static_page`, `diagnosis_page`, `motions_page`, `sweep_page` and `exam_page` make one page each, from tables
(`table`, `table_files`), figures (`style`, `overlay`, `small_multiples`) and text (`text`). `provenance` states where a page comes from.
"""
