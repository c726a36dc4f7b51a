"""Analysis of recordings: phases and valleys of strokes, compared with the model's."""
