"""What a fit may model beside the maps, and how it decides."""
