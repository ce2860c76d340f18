"""Images in, marker and pad poses in the camera frame out."""
