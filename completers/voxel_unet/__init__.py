"""Volumetric inpainting: a 3D U-Net over voxels of the observed cloud says where surface is missing."""
