"""Files that are whole or not there, and checks of what strangers' files claim."""
