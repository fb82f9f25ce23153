from .series import ImageSeries, read_image_sequence, read_images

__all__ = ["ImageSeries", "read_image_sequence", "read_images"]
