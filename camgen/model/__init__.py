"""The nouns, as frozen values: part, tool path, tour, program, job, and what they are made of."""
