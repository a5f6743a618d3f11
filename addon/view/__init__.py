"""What is drawn in the 3D viewports, and what lies under the mouse there."""
