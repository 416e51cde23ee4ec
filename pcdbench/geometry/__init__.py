"""Pure functions on arrays: neighbours, sampling, voxels, projection, visibility, registration."""
