"""Images as files: an OCI layout, what is in its layers, and a list of their packages.

Takes bytes, of this machine or of a stranger; gives documents and values, or ValueError. Pure: no file is opened, no
engine asked, and nothing of an image is run.

    layout      names of files, and the documents of a layout as srprov writes it
    layout_read a layout as somebody wrote it, within limits
    packing     a layer's tar -> gzip, always the same bytes
    members     a layer's tar -> its members, whatever tool wrote it
    databases   layers -> the files in which an image says what is installed in it
    packages    these files -> packages
    sbom        packages -> a CycloneDX document, and back
"""
