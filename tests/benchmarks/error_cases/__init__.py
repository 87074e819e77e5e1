"""Problems with a known answer for the study of error against time."""
