"""Model of spacecraft: fields, craft, equations of motion, random numbers, time."""
