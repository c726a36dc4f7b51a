"""From static stages, photographed and weighed, to the torque over rotation of the hinges."""
