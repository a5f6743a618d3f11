"""What every room uses: errors, progress, options."""
