"""Pictures of a flow in three dimensions: window, still, film, and files for ParaView.

A process of its own draws (:mod:`runout.view.process`), because VTK ends the process where it finds no OpenGL.
"""
