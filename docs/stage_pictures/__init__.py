"""The pictures of the stage pages, a module for each room of the library."""
