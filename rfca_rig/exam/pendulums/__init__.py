"""Cases of the exam on pendulums: `cases` draws them, `world` simulates them, `campaign` writes
them with their truth.
"""
