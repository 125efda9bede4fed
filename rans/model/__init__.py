"""What flies and how it moves: fields, spacecraft, equations of motion, random numbers, time."""
