"""Learner of RANS from the commands of an expert: `rans train --set algorithm=imitation`."""
