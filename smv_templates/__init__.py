"""The SMV encodings, as Jinja2 templates beside this file."""
