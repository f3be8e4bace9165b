"""Names and the things they stand for: machines, plants, controllers, contours."""
