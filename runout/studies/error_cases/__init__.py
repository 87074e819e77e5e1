"""Problems with a known answer, solved with one choice changed at a time: what accuracy costs."""
