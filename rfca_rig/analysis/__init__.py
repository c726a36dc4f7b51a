"""What recordings say: phases and valleys of strokes, set against the model's."""
